import cv2

cv2.setNumThreads(1)
