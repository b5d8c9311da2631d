"""The video itself: frames in order, backwards and one by one, with the container's own times."""
