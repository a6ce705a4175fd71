"""Flow through the gap and through the spots of a contact, from fields of a periodic cell. Knows no runs."""
