"""The live page: a session in real time in a process of its own, seen and moved in a browser."""
