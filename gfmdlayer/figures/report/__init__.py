"""The page of results: one HTML file with curves, surfaces, cases and provenance, for a browser."""
