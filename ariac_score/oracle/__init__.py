"""A WebSocket oracle for the monitors that ROSMonitoring generates, or anybody's with the same protocol."""
