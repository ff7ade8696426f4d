"""Trial and team configurations of every edition."""
