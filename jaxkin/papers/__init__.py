"""One file a paper: makes its figures and tables, and checks what it prints."""
