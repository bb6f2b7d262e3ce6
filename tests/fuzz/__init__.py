"""Mutation fuzzing of all that is read from files; `scripts/attacks.py` runs it in full."""
