"""From the scores of jobs to leaderboards: figures, ranks, tables, files."""
