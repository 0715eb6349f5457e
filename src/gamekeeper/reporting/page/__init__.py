"""The report as one page: typed data of each section, packed episodes, templates."""
