"""What can be seen to be wrong before anything long begins: pure functions of what a flight says and its files hold."""
