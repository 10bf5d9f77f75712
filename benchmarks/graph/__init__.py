"""The graph beside a bare one: same processes, topics, messages and rates, empty callbacks."""
