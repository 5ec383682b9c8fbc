// Written by `tests/types.rs` of the server: events as they are really sent. The compiler holds the page's types to them.

import type { FlightEvent } from "./events.ts";

export const examples = [
  {"event":"scene","name":"room","cameras":[{"name":"cam1","width_px":640,"height_px":480,"centre_m":[1.0,2.0,3.0],"corners":[[0.5,0.5,1.0],[0.5,0.5,1.0],[0.5,0.5,1.0],[0.5,0.5,1.0]]}],"markers":[{"name":"red","rgb":[219,18,18],"in_body_m":[0.25,0.25,0.5],"diameter_m":0.05}],"volume_m":[[-2.0,-2.0,0.0],[2.0,2.0,2.5]]},
  {"event":"pose","t_s":1.5,"sequence":90,"captured_ns":1795000000000000000,"valid":true,"tracking":"tracking","position_m":[1.0,2.0,3.0],"attitude":[0.5,0.5,0.5,0.5],"euler_rad":[0.1,0.2,0.3],"covariance":[0.25,0.25,0.25,0.25,0.25,0.25,0.25,0.25,0.25,0.25,0.25,0.25,0.25,0.25,0.25,0.25,0.25,0.25,0.25,0.25,0.25],"velocity_in_body_m_s":[0.5,0.5,0.5],"velocity_std_m_s":[0.5,0.5,0.5],"rates_rad_s":[0.5,0.5,0.5],"rates_std_rad_s":[0.5,0.5,0.5],"residual_px":0.25,"latency_ms":0.75,"reason":null},
  {"event":"detections","camera":0,"t_s":1.5,"seen":[{"u_px":1.5,"v_px":2.5,"diameter_px":9.5,"marker":0,"residual_px":[0.1,0.2]},{"u_px":1.5,"v_px":2.5,"diameter_px":9.5,"marker":null,"residual_px":null}]},
  {"event":"pose","t_s":1.5,"sequence":90,"captured_ns":1795000000000000000,"valid":false,"tracking":"acquiring","position_m":null,"attitude":null,"euler_rad":null,"covariance":null,"velocity_in_body_m_s":null,"velocity_std_m_s":null,"rates_rad_s":null,"rates_std_rad_s":null,"residual_px":null,"latency_ms":0.75,"reason":"hidden"},
  {"event":"pose","t_s":1.5,"sequence":90,"captured_ns":1795000000000000000,"valid":false,"tracking":"lost","position_m":null,"attitude":null,"euler_rad":null,"covariance":null,"velocity_in_body_m_s":null,"velocity_std_m_s":null,"rates_rad_s":null,"rates_std_rad_s":null,"residual_px":null,"latency_ms":0.75,"reason":"hidden"},
  {"event":"pose","t_s":1.5,"sequence":90,"captured_ns":1795000000000000000,"valid":false,"tracking":"reacquired","position_m":null,"attitude":null,"euler_rad":null,"covariance":null,"velocity_in_body_m_s":null,"velocity_std_m_s":null,"rates_rad_s":null,"rates_std_rad_s":null,"residual_px":null,"latency_ms":0.75,"reason":"hidden"},
  {"event":"camera","camera":0,"state":"starting","rate_hz":60.0,"latency_ms":0.5,"missing":3,"dropped":2,"markers":[1.0,0.5],"reason":"cable"},
  {"event":"camera","camera":0,"state":"running","rate_hz":60.0,"latency_ms":0.5,"missing":3,"dropped":2,"markers":[1.0,0.5],"reason":null},
  {"event":"camera","camera":0,"state":"stalled","rate_hz":60.0,"latency_ms":0.5,"missing":3,"dropped":2,"markers":[1.0,0.5],"reason":"cable"},
  {"event":"camera","camera":0,"state":"gone","rate_hz":60.0,"latency_ms":0.5,"missing":3,"dropped":2,"markers":[1.0,0.5],"reason":"cable"},
  {"event":"camera","camera":0,"state":"moved","rate_hz":60.0,"latency_ms":0.5,"missing":3,"dropped":2,"markers":[1.0,0.5],"reason":"cable"},
  {"event":"camera","camera":0,"state":"frozen","rate_hz":60.0,"latency_ms":0.5,"missing":3,"dropped":2,"markers":[1.0,0.5],"reason":"cable"},
  {"event":"camera","camera":0,"state":"dark","rate_hz":60.0,"latency_ms":0.5,"missing":3,"dropped":2,"markers":[1.0,0.5],"reason":"cable"},
  {"event":"parameters","t_s":1.5,"parameters":[{"name":"C_X.u","value":0.5,"half_width":0.25,"enough":true},{"name":"C_X.u","value":null,"half_width":null,"enough":false}],"enough":false},
  {"event":"recording","folder":"flight","seconds":1.5,"bytes":1000,"fault":null},
  {"event":"recording","folder":null,"seconds":1.5,"bytes":1000,"fault":"the disk is full"},
  {"event":"note","t_s":1.5,"fault":false,"text":"calibrated"},
] satisfies FlightEvent[];
