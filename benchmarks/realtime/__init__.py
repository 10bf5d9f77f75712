"""What real-time scheduling and pinned processors bring to the graph."""
