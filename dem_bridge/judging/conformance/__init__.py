"""Grade any code on frozen and unseen scenes, one question an item; the stored files can be judged again."""
