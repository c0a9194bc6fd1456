"""Writers of reports: Markdown tables, blocks in hand-written files, and HTML pages."""
