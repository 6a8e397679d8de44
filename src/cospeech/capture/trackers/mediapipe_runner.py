"""MediaPipe 0.10.21 over a film's pictures. A program of its own, for an environment of its own.

    python -I mediapipe_runner.py WIDTH HEIGHT RECORDS < pictures

Standard input is, for each picture, one byte (1 where a new shot begins) and WIDTH * HEIGHT * 3 bytes of RGB. RECORDS
becomes float32 rows, one a picture: for each part of LAYOUT its score (0 = not seen) and its K points of (x, y in
pixels; x, y, z in metres, for the face in pixels; score). It imports nothing of this project.

The body is searched in the whole picture, each hand in a square about its wrist and the face in one about the eyes and
nose: hands and faces are small in a picture of the whole person, and the speaker's own are meant, nobody else's.
"""

import sys

import cv2
import numpy as np

LAYOUT = (("body", 33), ("left_hand", 21), ("right_hand", 21), ("face_landmarks", 478))
NOSE, EARS, SHOULDERS = 0, (7, 8), (11, 12)
ARMS = {"left_hand": (13, 15, (17, 19)), "right_hand": (14, 16, (18, 20))}  # elbow, wrist, (little, index) of the body
# Squares in which a hand is searched: side in shoulder widths or forearms, and whether the forearm is turned upright
# in it (palms seen from their edge are found better so).
HAND_CROPS = ((1.1, False), (1.0, True), (0.8, False), (1.4, True))
TRIES = 2  # squares tried in one picture; a hand that was lost is searched in the next ones
HAND_REACH = 0.3  # how far from the body's wrist that of the hand may lie, in the same
FACE_CROP = 2.4  # side of the face's square, in distances between the ears, or 0.7 shoulder widths
IDENTITY = np.eye(2, 3, dtype=np.float32)
LEAST_CROP = 24  # pixels; smaller crops show nothing


class Runner:
    """The three solutions, and what each saw last."""

    def __init__(self, width, height):
        from mediapipe import solutions

        self.size = np.array([width, height], np.float32)
        self.pose = solutions.pose.Pose(model_complexity=1, smooth_landmarks=False)
        self.hands = {
            side: solutions.hands.Hands(max_num_hands=2, min_detection_confidence=0.2, min_tracking_confidence=0.3)
            for side in ARMS
        }
        self.crops = dict.fromkeys(ARMS, 0)
        self.face = solutions.face_mesh.FaceMesh(refine_landmarks=True, max_num_faces=2)

    def reset(self):
        """Forget the last picture: a new shot begins."""
        for solution in (self.pose, self.face, *self.hands.values()):
            solution.reset()

    def see(self, rgb):
        """One record: {part: (score, points (K, 6))}; parts not seen are absent."""
        found = self.pose.process(rgb)
        if found.pose_landmarks is None:
            return {}
        body = self._points(found.pose_landmarks, found.pose_world_landmarks)
        body[:, 5] = np.clip([point.visibility for point in found.pose_landmarks.landmark], 0, 1)
        parts = {"body": (float(body[list(SHOULDERS), 5].mean()), body)}
        unit = max(np.linalg.norm(body[11, :2] - body[12, :2]), 0.45 * np.linalg.norm(self._torso(body)))
        for side in ARMS:
            parts |= self._hand(rgb, body, side, unit)
        return parts | self._face(rgb, body, unit)

    @staticmethod
    def _torso(body):
        return body[[11, 12], :2].mean(axis=0) - body[[23, 24], :2].mean(axis=0)

    def _hand(self, rgb, body, side, unit):
        elbow, wrist, knuckles = ARMS[side]
        unit = max(unit, np.linalg.norm(body[elbow, :2] - body[wrist, :2]))
        centre = 0.35 * body[wrist, :2] + 0.65 * body[list(knuckles), :2].mean(axis=0)
        for _ in range(TRIES):
            scale, upright = HAND_CROPS[self.crops[side]]
            up = centre - body[elbow, :2] if upright else (0.0, -1.0)
            crop, back = cut(rgb, centre, scale * unit, up)
            best = None if crop is None else self._nearest_hand(crop, back, body[wrist, :2], side, HAND_REACH * unit)
            if best is not None:
                return {side: best}
            self.crops[side] = (self.crops[side] + 1) % len(HAND_CROPS)
        return {}

    def _nearest_hand(self, crop, back, wrist, side, reach):
        """(score, points) of the hand in a crop whose wrist is the body's, or None."""
        found, best, doubt = self.hands[side].process(crop), None, 0.5 * reach
        for points, world, label in zip(
            found.multi_hand_landmarks or (),
            found.multi_hand_world_landmarks or (),
            found.multi_handedness or (),
            strict=True,
        ):
            array = self._points(points, world, crop, back)
            # the labels are meant for pictures that are mirrored as a selfie is: the other side's name is right
            wrong = label.classification[0].label.lower() == side.split("_")[0]
            distance = np.linalg.norm(array[0, :2] - wrist) + wrong * doubt
            if distance < reach:
                array[:, 5] = label.classification[0].score
                best, reach = (float(array[0, 5]), array), distance
        return best

    def _face(self, rgb, body, unit):
        ears = np.linalg.norm(body[EARS[0], :2] - body[EARS[1], :2])
        crop, back = cut(rgb, body[[NOSE, *EARS], :2].mean(axis=0), FACE_CROP * max(ears, 0.35 * unit))
        if crop is None:
            return {}
        found = self.face.process(crop)
        faces = [self._points(points, None, crop, back) for points in found.multi_face_landmarks or ()]
        if not faces:
            return {}
        points = min(faces, key=lambda face: np.linalg.norm(face[1, :2] - body[NOSE, :2]))
        points[:, 5] = 1.0
        return {"face_landmarks": (1.0, points)}

    def _points(self, image, world, crop=None, back=IDENTITY):
        """(K, 6) of one solution's points; `back` (2, 3) takes pixels of the crop to the picture's."""
        size = self.size if crop is None else np.array(crop.shape[1::-1], np.float32)
        array = np.zeros((len(image.landmark), 6), np.float32)
        array[:, :2] = np.float32([(p.x, p.y) for p in image.landmark]) * size @ back[:, :2].T + back[:, 2]
        if world is None:  # the face: z has the scale of x
            array[:, 2:4] = array[:, :2]
            array[:, 4] = [p.z * size[0] for p in image.landmark]
        else:
            array[:, 2:5] = [(p.x, p.y, p.z) for p in world.landmark]
            turn = back[:, :2] / np.sqrt(abs(np.linalg.det(back[:, :2])))
            array[:, 2:4] = array[:, 2:4] @ turn.T
        return array


def cut(rgb, centre, side, up=(0.0, -1.0)):
    """A square of `side` pixels about `centre` in which `up` points up, black beyond the picture.

    Returns it and the (2, 3) matrix that takes its pixels to the picture's; None twice where it would show nothing.
    """
    length = np.hypot(*up)
    if not (np.isfinite(centre).all() and side >= LEAST_CROP and length > 0):
        return None, None
    height, width = rgb.shape[:2]
    if not (-side / 2 < centre[0] < width + side / 2 and -side / 2 < centre[1] < height + side / 2):
        return None, None
    side = round(float(side))
    down = -np.asarray(up) / length
    axes = np.column_stack([[down[1], -down[0]], down])
    back = np.column_stack([axes, np.asarray(centre) - axes @ [side / 2, side / 2]]).astype(np.float32)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return cv2.warpAffine(rgb, back, (side, side), flags=flags), back


def record(parts):
    """The row of one picture."""
    row = []
    for name, count in LAYOUT:
        score, points = parts.get(name, (0.0, np.zeros((count, 6), np.float32)))
        row += [np.float32([score]), points.ravel()]
    return np.concatenate(row).astype(np.float32)


def main(width, height, path):
    runner, count = Runner(width, height), width * height * 3
    with open(path, "wb") as records:
        while head := sys.stdin.buffer.read(1):
            pixels = sys.stdin.buffer.read(count)
            if len(pixels) < count:
                sys.exit("the last picture is incomplete")
            if head[0]:
                runner.reset()
            records.write(record(runner.see(np.frombuffer(pixels, np.uint8).reshape(height, width, 3))).tobytes())


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3])
