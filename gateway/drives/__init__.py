"""Register maps of drives: the schema, and later the shipped profiles."""
