"""From a path to a result: measure with plugins, price with the rule set."""
