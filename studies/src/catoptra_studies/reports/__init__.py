"""Writers of reports: Markdown tables, generated blocks in hand-written files, HTML pages."""
