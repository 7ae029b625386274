"""Players: things that answer a prompt - random, rule-based, a model, a person."""
