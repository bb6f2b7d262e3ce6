"""Basics of all rooms: errors, atomic files, plain values, threads, the journal, formulas of fit."""
