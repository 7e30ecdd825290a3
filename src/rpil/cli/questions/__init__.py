"""Questions about demonstrations: one loop of answers for the terminal and for a page, and the server of the page."""
