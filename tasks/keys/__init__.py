"""Keys of artifacts, and the digests of source code that go into them."""
