#pragma once

#include <locale.h>  // NOLINT(modernize-deprecated-headers): locale_t
#include <algorithm>
#include <clocale>
#include <cstdarg>
#include <cstdio>
#include <string>

namespace acmp {

/// While it lives, numbers that this thread reads and writes with C's functions (strtod, stod, printf) have a decimal
/// point, also where the process has called setlocale, as a Python script or a desktop program may: in de_DE "0.5"
/// would be 0, and 0.5 would be "0,5". Streams are given std::locale::classic() where they are made.
class ClassicLocale {
 public:
  ClassicLocale() : previous_(uselocale(Classic())) {}
  ~ClassicLocale() { uselocale(previous_); }
  ClassicLocale(const ClassicLocale&) = delete;
  ClassicLocale& operator=(const ClassicLocale&) = delete;

 private:
  static locale_t Classic() {
    static const locale_t classic = newlocale(LC_ALL_MASK, "C", nullptr);
    return classic;
  }

  const locale_t previous_;
};

/// What printf makes of it, with a decimal point.
__attribute__((format(printf, 1, 2))) inline std::string StringPrintf(const char* format, ...) {
  const ClassicLocale point;
  std::va_list values, again;
  va_start(values, format);
  va_copy(again, values);
  std::string text(static_cast<size_t>(std::max(0, std::vsnprintf(nullptr, 0, format, values))), '\0');
  std::vsnprintf(text.data(), text.size() + 1, format, again);
  va_end(again);
  va_end(values);
  return text;
}

}  // namespace acmp
