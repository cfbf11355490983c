"""Register maps of drives: the schema and the shipped profiles."""
