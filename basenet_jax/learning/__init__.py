"""How the policies learn."""
