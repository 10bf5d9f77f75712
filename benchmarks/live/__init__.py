"""The live page: pictures a second, and from the mouse to its force."""
