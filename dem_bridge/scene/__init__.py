"""The problem as a frozen value: bodies, contacts, walls, drive, the features that it has, and its files."""
