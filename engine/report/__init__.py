"""Reports for people: text on the console, plots, HTML pages."""
