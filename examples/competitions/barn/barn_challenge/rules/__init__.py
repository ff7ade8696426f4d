"""The rule sets of the BARN Challenge."""
