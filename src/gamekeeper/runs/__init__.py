"""Evidence on disk: written as it happens, finalized, recovered, replayed."""
