// The MVSNet layout: pair.txt, cams/00000000_cam.txt, cams/00000001_cam.txt.

#include "fuzz/fuzz_scene.h"

ACMP_FUZZ_TARGET(mvsnet) {
  static const acmp::fuzz::SceneFolder folder;
  const auto parts = acmp::fuzz::Parts(data, size, 3);
  folder.Write("pair.txt", parts[0]);
  folder.Write("cams/00000000_cam.txt", parts[1]);
  folder.Write("cams/00000001_cam.txt", parts[2]);
  folder.Read(acmp::SceneFormat::kMvsnet);
  return 0;
}
