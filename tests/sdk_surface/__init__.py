"""The vendor SDK's surface beyond its manual, as docs/generated/sdk-compat.md lists it."""
