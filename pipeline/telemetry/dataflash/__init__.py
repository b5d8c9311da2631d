"""ArduPilot DataFlash logs (.bin, .log): what each message means."""
