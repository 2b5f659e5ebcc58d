// A scene's cameras.txt.

#include "acmp_mapping/dataset/camera_list.h"
#include "fuzz/fuzz_input.h"

ACMP_FUZZ_TARGET(camera_list) {
  static const acmp::fuzz::Folder folder;
  const auto path = folder.Write("cameras.txt", acmp::fuzz::Bytes(data, size).Rest());
  acmp::fuzz::MayRefuse([&] { acmp::ReadCameraList(path); });
  return 0;
}
