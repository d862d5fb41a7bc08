"""The store: artifacts by their keys, in a folder or at an address."""

from vastflow.tasks.store.artifact import Lost, StoreError

__all__ = ["Lost", "StoreError"]
