"""What a call asks for: the campaign file read and checked, its keys, what of it is wanted."""
