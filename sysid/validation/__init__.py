"""Fits judged on records that they have not seen."""
