"""A scene for every sentence of the SDK's own description; docs/sdk_compat.md is the table."""
