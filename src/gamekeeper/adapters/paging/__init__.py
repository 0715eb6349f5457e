"""What a page of the report is put together from: documents, episodes, twins, pictures."""
