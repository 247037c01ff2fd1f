"""Documents that people write: text files of plain data, read within bounds, with errors that name the field."""
