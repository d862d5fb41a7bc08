"""What a user can mend: the root of all errors that end a command with exit code 2."""


class UserError(Exception):
    """A mistake in a file, an option or an argument, or of the machine; says where, what was found and what would be right."""
