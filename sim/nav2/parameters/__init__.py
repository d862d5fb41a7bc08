"""Parameters of the navigation stack: Nav2's names, the values of Nav2 Jazzy's default file."""
