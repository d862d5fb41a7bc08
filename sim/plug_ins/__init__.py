"""Plug-ins: snapshots of users' code, called so that it can't end vastflow."""
