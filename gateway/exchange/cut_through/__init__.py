"""Cut-through: frames that leave while they still arrive, on serial lines."""
