"""The oracles that come with vastflow, one file and one entry point each."""
