"""A record from its file to finished numbers."""
