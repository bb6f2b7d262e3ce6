"""Where a search starts: one file a kind of chain."""
