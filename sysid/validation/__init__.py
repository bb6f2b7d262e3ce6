"""Fits judged on validation data."""
