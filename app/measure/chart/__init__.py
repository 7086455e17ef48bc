"""Error against frame time of many settings: table, chart and page."""
