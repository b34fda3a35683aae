"""From pictures to measurements: features, matches, tracks, homographies, columns. Plain functions."""
