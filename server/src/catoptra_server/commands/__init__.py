"""The commands of `catoptra-server`: to serve, and to explain, list, export and check."""
