"""A scene for every sentence of the SDK's own description; docs/seed.md is the table."""
