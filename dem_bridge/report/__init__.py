"""What people look at: figures (matplotlib) and the HTML page (jinja2). No numbers are computed here."""
