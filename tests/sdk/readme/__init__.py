"""A scene for every sentence of the SDK's description; docs/generated/sdk-sentences.md has all."""
