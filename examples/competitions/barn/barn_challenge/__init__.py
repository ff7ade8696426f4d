"""The BARN Challenge as a guest: its readers, its monitor, its rule sets."""
