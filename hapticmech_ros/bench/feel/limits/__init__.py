"""How stiff, how light, how deep: what a rendering can do, beside what theory says it can."""
