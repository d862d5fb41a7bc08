"""Plug-ins: the code of others, as it was when keys were made, and entered so that it can't end vastflow."""
