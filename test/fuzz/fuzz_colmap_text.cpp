// A COLMAP model, text: cameras.txt, images.txt, points3D.txt.

#include "fuzz/fuzz_scene.h"

ACMP_FUZZ_TARGET(colmap_text) {
  static const acmp::fuzz::SceneFolder folder;
  const auto parts = acmp::fuzz::Parts(data, size, 3);
  folder.Write("sparse/cameras.txt", parts[0]);
  folder.Write("sparse/images.txt", parts[1]);
  folder.Write("sparse/points3D.txt", parts[2]);
  folder.Read(acmp::SceneFormat::kColmap);
  return 0;
}
