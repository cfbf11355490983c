"""``pitch-gateway table edit``: a table seen and edited on a page of this computer."""
