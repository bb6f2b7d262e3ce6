"""Tests on a record or on residuals: advice, whitening, residual tests, best linear approximation."""
