"""Light that goes below surfaces: which paths do, and how they walk until they come out."""
