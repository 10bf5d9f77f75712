"""The reliability campaign: clocks, doubles, kills, networks, files and bytes against the graph."""
