"""What a referee reads, made from a rule set, its plugins, and trials made for it."""
