"""Operations on single images and maps."""
