"""From columns of messages to the signals, orders and events of one trial."""
