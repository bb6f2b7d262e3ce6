"""Structure search."""
