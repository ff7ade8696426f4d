"""From many scored runs to a ranking: attempts, cohort, sums, judges, ranks, ties."""
