"""A log as other programs want it: tables, tracks on a map, sentences, pictures (`wayfix export`)."""
