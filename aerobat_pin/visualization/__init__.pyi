from .comparison import compare_runs as compare_runs
from .crank_by_hand import crank_page as crank_page
from .figures.estimation import draw_estimation as draw_estimation
from .figures.linkage import draw_linkage as draw_linkage
from .figures.linkage import linkage_animation as linkage_animation
from .figures.linkage import range_table as range_table
<<<<<<< HEAD
=======
from .recording_pages import write_recording_pages as write_recording_pages
from .replay.any_robot import replay_table as replay_table
>>>>>>> main
from .replay.flight_replay import SLOW_MOTION as SLOW_MOTION
from .replay.flight_replay import replay_flight as replay_flight
from .replay.flight_replay import replay_log as replay_log
from .replay.flight_replay import replay_run as replay_run
from .replay.open_robot import RobotView as RobotView
from .replay.open_robot import open_robot as open_robot
from .replay.recording import Recording as Recording
from .replay.recording import record as record
from .replay.result_replay import replay_result as replay_result
from .replay.serve import serve as serve
from .replay.snapshots import snapshots as snapshots
from .result_pages import draw_all as draw_all
from .result_pages import report_html as report_html
from .result_pages import write_figures_and_pages as write_figures_and_pages
from .style import render_figure as render_figure
from .style import save_figure as save_figure
