// A calibration file; the first byte says whether it is .yaml or .ini.

#include "acmp_mapping/ros/input_conversion.h"
#include "fuzz/fuzz_input.h"

ACMP_FUZZ_TARGET(calibration_file) {
  using namespace acmp;
  static const fuzz::Folder folder;
  fuzz::Bytes bytes(data, size);
  const char* name = bytes.Take<char>() == 'i' ? "camera.ini" : "camera.yaml";
  const auto path = folder.Write(name, bytes.Rest());
  fuzz::MayRefuse([&] { ToCalibration(ReadCalibrationFile(path.string()), false); });
  return 0;
}
