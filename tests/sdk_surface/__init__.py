"""The vendor SDK's surface beyond its manual: names, arguments, meanings; docs/generated/sdk-compat.md."""
