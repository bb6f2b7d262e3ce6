"""What a record or a row of residuals shows by itself: advice, whitening, residual tests, best linear approximation."""
