"""For tests of what reads ARIAC's records: the example trial in its messages, its official documents."""
