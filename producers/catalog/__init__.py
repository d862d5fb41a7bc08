"""The producers that vastflow ships, one file each."""
