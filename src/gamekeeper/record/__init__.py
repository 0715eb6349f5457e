"""Evidence on disk: written as it happens, sealed, recovered, replayed."""
