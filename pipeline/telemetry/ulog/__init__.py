"""PX4 logs (.ulg): what each topic means."""
