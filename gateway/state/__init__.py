"""The state folder: the checked configuration and its tables as the relay starts from them."""
