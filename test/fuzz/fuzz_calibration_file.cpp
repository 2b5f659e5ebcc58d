// A calibration file; the first byte says whether it is .yaml or .ini.

#include "acmp_mapping/ros/calibration_file.h"
#include "acmp_mapping/ros/input_conversion.h"
#include "fuzz/fuzz_input.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace acmp;
  static const fuzz::Folder folder;
  fuzz::Bytes bytes(data, size);
  const char* name = bytes.Take<char>() == 'i' ? "camera.ini" : "camera.yaml";
  const auto path = folder.Write(name, bytes.Rest());
  fuzz::MayRefuse([&] { ToCalibration(ReadCalibrationFile(path.string()), false); });
  return 0;
}
