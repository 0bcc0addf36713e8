"""A scene for every sentence of the SDK's own description; docs/generated/sdk-sentences.md is the table."""
