"""Ways of a message from one process to another of the same host, compared."""
