"""Other people's formats: recordings of poses in, tables out."""
