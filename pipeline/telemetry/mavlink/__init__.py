"""MAVLink logs (.tlog, raw captures): whose messages, and what each of them means."""
