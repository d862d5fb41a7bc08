"""The explorer: campaigns in the browser, while they run and afterwards."""
