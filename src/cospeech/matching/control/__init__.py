"""Control: where and how the hands move, gestures called by words, and frames replaced."""
