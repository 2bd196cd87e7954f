"""The laboratory: scenarios x filters x seeds, beside the published tables and the bound nobody can beat."""
