"""What the commands print and write: reports, tables, pictures, films and exports that a user asks for."""
