"""What an unmodified simulator publishes of submissions and scores, without a node of anybody's."""
