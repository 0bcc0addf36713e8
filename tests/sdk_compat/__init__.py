"""A scene for every sentence of the SDK's own description; docs/sdk-sentences.md is the table."""
