"""Small environments written as strangers write them, and their audits."""
