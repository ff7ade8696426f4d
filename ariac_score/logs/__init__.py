"""Built-in readers, found through the same entry points as anyone's."""
