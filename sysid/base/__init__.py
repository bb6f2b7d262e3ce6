"""What every room stands on: errors, atomic files, plain values, threads, the journal, formulas of fit."""
