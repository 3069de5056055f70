"""What other programs read: tables of a scene's parameters and of what was found, in every usual format."""
