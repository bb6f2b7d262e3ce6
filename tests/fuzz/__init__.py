"""Mutation fuzzing of all that is read from files; `scripts/fuzz.py` runs it in full."""
