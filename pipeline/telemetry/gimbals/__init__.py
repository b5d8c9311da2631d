"""What a gimbal's angles count from, whatever the format: flags, and the vehicle's motion."""
